"""PPO on the tasks of the package and on tasks of your own."""
