"""From a case file to files: what every folder may use stands here."""
