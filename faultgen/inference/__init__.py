"""What a difference says: one probabilistic model of arrays, for every question about a difference.

y = S b + A a + n, with numbers b that may differ in a healthy robot, effects a, and noise n; see
`model`. Nothing here knows robots or simulates.
"""
