"""What an arm can reach: its kinematics, inverse kinematics, and maps that are built once and looked up in a reset."""
