"""The models of the thesis: circuit, resonators on beams, velocity feedback, shaped beams, the amplitude loop."""
