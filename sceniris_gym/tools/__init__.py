"""What the command line offers: audit, benchmark, pictures."""
