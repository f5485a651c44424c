"""What in a file is a frame? Binary formats, and what all formats share: frames, times, the account of every byte."""
