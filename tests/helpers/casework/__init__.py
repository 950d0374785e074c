"""What tests/helpers/cases.py is made of: shapes, writers, tables of cases, and mutations."""
