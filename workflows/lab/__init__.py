"""What judges and shows the product: verification, benchmarks, studies, pages; nothing of the product imports it."""
