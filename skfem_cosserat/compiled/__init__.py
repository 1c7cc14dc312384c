"""Kernels compiled by numba; imported only where they are used, see integrators/fast.py."""
