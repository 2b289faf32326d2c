"""Makes frames between keyframes."""
