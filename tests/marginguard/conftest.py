"""Fields of the shipped case are computed once for all tests of the API."""

from tests.field_cache import fields_folder as fields_folder
from tests.field_cache import shared_fields as shared_fields
