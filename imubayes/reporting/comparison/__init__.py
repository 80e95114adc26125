"""Results side by side: what differs beyond uncertainty."""
