"""Start of the pages' server: apart from what it serves, so that its workers do not load it again."""

if __name__ == "__main__":
    from sinew.apps.dashboard.page_server import main

    main()
