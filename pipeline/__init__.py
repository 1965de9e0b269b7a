"""Files in, files out: cases, steps, batch runs, pictures, exports."""
