"""From a campaign file to stored runs. Folders: `syntax`, `definition`, `reading`, `running`; `derived_cards.py`."""
