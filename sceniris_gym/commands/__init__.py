"""The work of the commands: a file for each, of its name."""
