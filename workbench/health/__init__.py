"""What an FMU or a system says of itself, and whether it is true."""
