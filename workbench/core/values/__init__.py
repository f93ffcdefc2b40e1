"""Values that all layers know: units, linear models, responses, margins, operating points."""
