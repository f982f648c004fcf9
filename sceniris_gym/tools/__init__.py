"""The tools behind the command line: commands, audit, tables of layouts and pictures."""
