"""What a closed loop tolerates."""
