"""The examples of Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677; programs in README.md."""
