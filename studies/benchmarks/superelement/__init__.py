"""The reduced cell beside full solves of the same mesh: time, memory, errors, and how alike the modes are."""
