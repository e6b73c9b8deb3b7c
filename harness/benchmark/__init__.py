"""All domains × all policies: one table, one figure a policy, one page, in a folder that is gone on with."""
