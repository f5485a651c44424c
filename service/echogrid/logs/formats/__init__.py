"""How each format of a recording becomes CAN frames, with an account of every line or object that did not."""
