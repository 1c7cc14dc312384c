"""The version, in one place: the build, the package and its files read it here."""

VERSION = "0.2.0"

_BIBTEX = """\
@software{skfem_cosserat,
  author = {{The skfem_cosserat developers}},
  title = {skfem-cosserat: geometrically exact beams and flexible multibody dynamics for
    scikit-fem},
  version = {%s},
  year = {2026}
}
@article{leyendecker_marsden_ortiz_2008,
  author = {Leyendecker, Sigrid and Marsden, Jerrold E. and Ortiz, Michael},
  title = {Variational integrators for constrained dynamical systems},
  journal = {ZAMM - Journal of Applied Mathematics and Mechanics},
  volume = {88},
  number = {9},
  pages = {677--708},
  year = {2008},
  doi = {10.1002/zamm.200700173}
}
"""


def citation() -> str:
    """BibTeX of this version of the software and of the paper whose formulation it has.

    Examples
    --------
    >>> [line for line in citation().splitlines() if line.startswith("@")]
    ['@software{skfem_cosserat,', '@article{leyendecker_marsden_ortiz_2008,']
    """
    return _BIBTEX % VERSION
