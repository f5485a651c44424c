"""What is published: the topics, and their messages as bytes."""
