"""Parts of compiled kernels for scenes that are confined to a plane: three unknowns a frame.

With complex numbers for vectors of the plane a frame is its origin x and a unit vector e: its
directors are ``d_i = k_i e`` with constants k_i, and what they have along the normal never changes.
So y has four numbers a frame, (x, e), forces are gathered as ``f_e = sum conj(k_i) f_i``, strains
are ``gamma = conj(e) phi'`` and ``kappa = Im(conj(e) e')`` (Gamma_i is ``Re(conj(k_i) gamma)``, K_i
a multiple of kappa), and a twist (v, omega) moves a frame by ``dx = v``, ``de = i omega e``.
Rows of y in space are taken where a step starts, and made where it ends. The loop over a step and
the elimination are those of :mod:`skfem_cosserat.compiled`.
"""
