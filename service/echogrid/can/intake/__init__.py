"""How do frames come in, many at once? Batches of them, and the socket that receives them."""
