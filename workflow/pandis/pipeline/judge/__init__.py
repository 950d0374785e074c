"""What fields are worth: errors, stress, timing, the servo loop, and the choice by these."""
