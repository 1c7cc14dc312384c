"""Kernels compiled by numba, which is imported only to compile; see README.md."""
