"""What an FMU or a system is and can do."""
