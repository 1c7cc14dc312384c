"""Kernels compiled by numba; see README.md. Imported where they are used only:
integrators/compiled_step.py for steps, statics/solver.py for equilibria.
"""
