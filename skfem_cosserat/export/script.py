"""The script for ParaView that is written beside its files."""

SCRIPT = """
"""
