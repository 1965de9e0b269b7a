"""Scenes, meshes and synthetic studies that several tests share."""
