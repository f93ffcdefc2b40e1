/* fmiPlatformTypes.h: types of FMI 1.0 for Co-Simulation, written from the standard; those of Model Exchange. */
#ifndef fmiPlatformTypes_h
#define fmiPlatformTypes_h

#include "fmiModelTypes.h"

#define fmiPlatform fmiModelTypesPlatform

#endif
