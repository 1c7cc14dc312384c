"""Columns of the tables that bind modules make and kernels read; numba is not imported here."""
