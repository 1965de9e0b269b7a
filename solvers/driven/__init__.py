"""What patches make of a driven plate together: contrast of zone and passive face, travelling waves, power flow."""
