"""Files, scratch folders, arithmetic, interrupts."""
