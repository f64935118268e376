// The texts that every exported source begins with: base/elementary.h and graph/source_products.h,
// line by line. The build makes them from these files.
#ifndef PM_GRAPH_SOURCE_TEXT_H
#define PM_GRAPH_SOURCE_TEXT_H

extern const char *const pm_source_elementary_text[]; // ends with NULL
extern const char *const pm_source_products_text[];   // ends with NULL

#endif
