"""What can be asked: options declared once, run here or in a worker, and what a result remembers of its making."""
