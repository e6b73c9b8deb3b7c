"""What a policy earns in expectation, with no sampling error: situations expanded forward, equal ones merged."""
