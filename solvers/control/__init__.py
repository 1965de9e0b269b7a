"""Active confinement: feedback on pillars, shaping by patches, and the rotating frame."""
