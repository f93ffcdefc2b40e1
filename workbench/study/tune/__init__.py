"""Parameters of a system that meet the requirements of a study."""
