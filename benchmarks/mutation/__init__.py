"""Do the tests notice small errors that are put into the code?"""
