"""What everything costs, in time and memory."""
