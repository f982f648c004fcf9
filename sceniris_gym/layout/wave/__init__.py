"""A wave of candidates: drawn, tested and accepted."""
