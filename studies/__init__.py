"""Studies about the tool itself, each run from the project's folder by ``python -m studies.NAME``.

They are no part of the installed package, and import what is below its public names where they measure that.
"""
