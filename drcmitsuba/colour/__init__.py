"""Colour of daylight: wavelengths, responses of the eye, spectra of sources and of surfaces.

Light in a band is stated as the illuminance [lx] of D65 light with the same spectral irradiance at
the band's wavelength. D65 light has the same number in all bands, and every response of the eye is
a weighted sum over bands whose weights add up to 1: illuminance, α-opic equivalent daylight
illuminances (CIE S 026), and tristimulus values per those of D65.
"""
