// The templates of instantiate.hpp themselves.
#define CONDYN_EXTERN
#include "instantiate.hpp"
