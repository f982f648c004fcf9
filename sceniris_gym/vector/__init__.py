"""The Gymnasium interface: vector environments and tasks."""
