"""What holds for all parameters in their ranges: stability and gain, by bounds and by the parameters that attain them."""
