"""What the commands do: one file for each, named as the command is."""
