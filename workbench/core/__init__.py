"""Values that all layers share: they know no model, no FMU and no analysis."""
