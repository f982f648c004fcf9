"""What a user writes: the words of a scene file, their values, and what is said of wrong ones."""
