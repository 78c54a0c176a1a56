"""How wide the intervals are that everything here is judged by."""

# Standard deviations from the mean of a normal distribution to the ends of the interval that
# holds nine tenths of it.
NINETY = 1.6448536269514722
