"""Evidence: computed beside references and other codes; README.md lists the programs."""
