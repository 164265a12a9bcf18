"""AutoWeather4D: change the weather and the time of day of recorded driving video."""
