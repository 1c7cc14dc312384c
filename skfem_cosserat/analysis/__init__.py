"""Parts that runs, paths of equilibria and modes share: start states, derived series, progress."""
