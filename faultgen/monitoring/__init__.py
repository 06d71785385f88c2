"""What a monitoring system sees of a cycle, and what it keeps."""
