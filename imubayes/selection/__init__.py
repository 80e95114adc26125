"""Which terms the data need: the models, the decision on them, and what other methods say of it.

==========  ==========================================================================================
models      `model_sets` and their prior, `mixture`, `models`, `evidence`, `enumerate`; beyond enumeration
            `search`, with `bounds`, `branching` and `model_walk`; compiled `lanes`, the tree, and `kernels`
decision    `verdicts`, the rule; `decision`, on one component
opinions    `criteria`, `predictive`, `sindy`, `sensitivity`, `compensations`; `panel` asks them all
            and puts them side by side, `causes` says why they differ
noise       `noise_choice`: which processes a run shows
==========  ==========================================================================================
"""
