"""Parameters of an FMU or system from measured data, and what the data can and cannot say of them."""
