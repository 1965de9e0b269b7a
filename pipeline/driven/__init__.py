"""What patches do on a case's plate beside its rows: shaped drives, travelling waves, their table on the board."""
