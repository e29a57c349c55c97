"""What follows from the search: verdict, confidence, the gap and how far it closes, the next experiment."""
