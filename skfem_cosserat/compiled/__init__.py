"""Kernels compiled by numba; see README.md. Imported where they are used, in functions."""
