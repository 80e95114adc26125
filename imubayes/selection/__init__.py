"""Which terms the data need: the models, the decision on them, and what other methods say of it.

==========  ==========================================================================================
models      `model_prior`, `model_sets`, `mixture`, `models`, `evidence`, `enumerate`; beyond enumeration
            `search`, with `bounds`, `branching` and `model_walk`; compiled `lanes`, the tree, and `kernels`
decision    `verdicts`, the rule; `decision`, on one component; `digits` that can be trusted
opinions    `criteria`, `predictive`, `effects`, `sindy`, `sensitivity`, `compensations`; `panel` asks
            them all and puts them side by side, `causes` says why they differ
noise       `noise_choice`: which processes a run shows
==========  ==========================================================================================
"""
