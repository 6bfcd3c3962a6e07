"""MRML nodes in general: conversion from and to values, batches of changes, integrity."""
