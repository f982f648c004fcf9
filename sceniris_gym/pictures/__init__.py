"""Pictures of layouts and of reachability maps."""
