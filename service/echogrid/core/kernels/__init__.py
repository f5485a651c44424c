"""Which loops are hot enough to be compiled, and what do they do? In plain numpy, and the same in C."""
