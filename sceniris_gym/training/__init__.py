"""PPO on the tasks of the package and on your tasks."""
