"""The version, in one place: the build, the package and its files read it here."""

VERSION = "0.2.0"
