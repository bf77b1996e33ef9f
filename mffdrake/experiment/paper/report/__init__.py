"""What came out? The report: its text, its tables, its pictures."""
