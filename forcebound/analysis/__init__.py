"""What a recorded run says: numbers (:mod:`.metrics`) and pictures (:mod:`.plots`)."""
