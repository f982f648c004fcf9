"""Translation for training libraries."""
