// The files of the page of a view (daemon/view), which the build embeds as arrays of lines that end
// with NULL.
#ifndef PM_APP_VIEW_PAGE_H
#define PM_APP_VIEW_PAGE_H

extern const char *const pm_view_html[];
extern const char *const pm_view_css[];
extern const char *const pm_view_js[];

#endif
