"""Between frames and parameters: poses read from images, drawn, rolled out, and what they tell refined."""
