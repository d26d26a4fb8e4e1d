"""Read records of an envelope (amplitude only), measure their noise floor, and find the free decay."""
