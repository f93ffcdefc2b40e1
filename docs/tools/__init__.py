"""What the documentation is built with: hooks of ProperDocs, generated pages, and the runner of its examples."""
