"""What the commands do: one file per command, with the command's name."""
