"""Systems with co-simulation components: a master that steps them from one communication point to the next."""
