"""What holds for all parameters in their ranges: stability and gain, proved, and the parameters that come nearest."""
