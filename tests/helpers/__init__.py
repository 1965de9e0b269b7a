"""Scenes, meshes and invented studies that several tests share."""
