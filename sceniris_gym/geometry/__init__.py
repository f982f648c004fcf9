"""What things are made of: pieces, the surfaces that carry, the poses that rest, and trees of boxes."""
