"""What the documentation is built with: hooks of MkDocs, generated pages, and the runner of its examples."""
