"""The documentation: pages in Markdown, and in `tools` what generates and tests them."""
