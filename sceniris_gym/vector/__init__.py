"""The Gymnasium face: vector environments and tasks."""
