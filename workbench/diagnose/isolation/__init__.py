"""Which effects the runs can tell apart, and which run would decide between open hypotheses."""
