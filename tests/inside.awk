# The header FILE without the bodies of its public functions, line for line, for a program that
# looks at private functions and is linked with the object that holds all: it compiles what it
# calls, and no more. Warnings of the header are the object's to give.
FNR == 1 { printf "#pragma GCC system_header\n#line 1 \"%s\"\n", FILENAME }
/^CLOTH_API/ { head = ""; open = 1 }
open { head = head $0 "\n"
       if (/;( *\/\*.*)?$/) { printf "%s", head; open = 0 }
       else if (/{.*}$|{$/) { gsub(/[^\n]/, "", head); printf "%s", head; open = 0; cut = /{$/ }
       next }
{ print cut ? "" : $0 }
/^}/ { cut = 0 }
