"""How much there is to earn: solutions of a domain, and the solvers that find them."""
