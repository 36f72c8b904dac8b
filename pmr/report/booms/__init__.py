"""What a report says of a boom of several sections."""
