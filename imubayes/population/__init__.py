"""Many units: lots that are drawn, fleets that were recorded, and the processes that share them."""
