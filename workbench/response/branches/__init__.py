"""All periodic responses of a forced model: branches over frequency, amplitude or a parameter."""
