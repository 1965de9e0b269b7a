"""One class a pillar shape: its keys, section, symmetry, solid, rim, outline, volume and printable limits."""
