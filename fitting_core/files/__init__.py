"""Files as a whole: written whole or not at all, looked at before they are opened, and arrays in checked archives."""
