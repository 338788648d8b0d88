"""The methods of the paper and of textbooks, block matrices, Gram factors: an annex that only the registry opens."""
