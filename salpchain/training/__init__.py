"""PPO on many chains at once, compiled as one program for each iteration."""
